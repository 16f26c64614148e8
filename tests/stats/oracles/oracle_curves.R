# Thresholds with their errors (MASS::dose.p), limits of a curve and deviance, by R; written to
# oracle_curves.json.
# Run: Rscript tests/stats/oracles/oracle_curves.R tests/stats/oracles
# Made with R 4.2.2 and MASS 7.3-58.2.
suppressMessages(library(MASS))
folder <- commandArgs(trailingOnly = TRUE)[1]
num <- function(x) paste0("[", paste(format(unname(c(x)), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))
d <- data.frame(method = rep(c("a", "b"), each = 5), level = rep(c(-2, -1, 0, 1, 2), 2),
                hits = c(1, 3, 9, 16, 19, 2, 4, 6, 12, 15), shown = 20)
d$method <- factor(d$method)
for (link in c("probit", "logit")) {
  m <- glm(cbind(hits, shown - hits) ~ 0 + method + method:level, binomial(link), d)
  for (k in 1:2) {
    found <- dose.p(m, cf = c(k, 2 + k), p = 0.5)
    put(paste0(link, "_", c("a", "b")[k], "_dose"), found)
    put(paste0(link, "_", c("a", "b")[k], "_error"), attr(found, "SE"))
  }
  fine <- data.frame(method = "a", level = c(-1.5, 0.2, 2))
  along <- predict(m, fine, type = "link", se.fit = TRUE)
  put(paste0(link, "_eta"), along$fit); put(paste0(link, "_eta_error"), along$se.fit)
  each <- function(of) sum(residuals(m, type = "deviance")[d$method == of]^2)
  put(paste0(link, "_deviance"), c(each("a"), each("b")))
}
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_curves.json"))
