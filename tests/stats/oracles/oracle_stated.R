# Thresholds at a stated performance with their errors (MASS::dose.p), the ratio of slopes, limits of
# a curve, deviance, and the share of right answers of d' = 1, by R; written to oracle_stated.json.
# Run: Rscript tests/stats/oracles/oracle_stated.R tests/stats/oracles
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
    found <- dose.p(m, cf = c(k, 2 + k), p = c(0.5, 0.75, 0.6))
    put(paste0(link, "_", c("a", "b")[k], "_dose"), found)
    put(paste0(link, "_", c("a", "b")[k], "_error"), attr(found, "SE"))
  }
  b <- coef(m)[3:4]; v <- vcov(m)[3:4, 3:4]; g <- c(1, -1) / b
  put(paste0(link, "_slopes"), c(log(b[1] / b[2]), sqrt(t(g) %*% v %*% g)))
  fine <- data.frame(method = "a", level = c(-1.5, 0.2, 2))
  along <- predict(m, fine, type = "link", se.fit = TRUE)
  put(paste0(link, "_eta"), along$fit); put(paste0(link, "_eta_error"), along$se.fit)
  each <- function(of) sum(residuals(m, type = "deviance")[d$method == of]^2)
  put(paste0(link, "_deviance"), c(each("a"), each("b")))
}
share <- function(m) integrate(function(x) dnorm(x - 1) * pnorm(x)^(m - 1), -9, 10)$value
put("d_prime_1", sapply(c(2, 3, 4), share))
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_stated.json"))
