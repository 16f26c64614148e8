# Bounds of package rpact for planned looks, written to oracle_sequential.json.
# Run: Rscript tests/stats/oracles/oracle_sequential.R tests/stats/oracles
# Made with R 4.2.2, rpact 3.3.4 (Debian).
suppressMessages(library(rpact))
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
for (rule in c("asOF", "asP")) for (t in list((1:5) / 5, (1:3) / 3, c(0.3, 0.55, 1), c(0.5, 1)))
  for (alpha in c(0.05, 0.01)) {
    d <- getDesignGroupSequential(typeOfDesign = rule, informationRates = t, alpha = alpha, sided = 2)
    name <- c(asOF = "obrien-fleming", asP = "pocock")[[rule]]
    out <- c(out, sprintf(' {"rule": "%s", "alpha": %g, "t": %s, "z": %s, "spent": %s}',
                          name, alpha, num(t), num(d$criticalValues), num(d$alphaSpent)))
  }
writeLines(c("[", paste(out, collapse = ",\n"), "]"),
           file.path(commandArgs(trailingOnly = TRUE)[1], "oracle_sequential.json"))
