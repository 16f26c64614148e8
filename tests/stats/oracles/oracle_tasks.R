# Numbers of R for the statistics of tasks with right answers, written to oracle_tasks.json.
# Run: Rscript tests/stats/oracles/oracle_tasks.R tests/stats/oracles
# Made with R 4.2.2, glmmTMB 1.1.5.
suppressMessages(library(glmmTMB))
args <- commandArgs(trailingOnly = TRUE)
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))

d <- read.csv(file.path(args[1], "crossed.csv"))
d$x <- ifelse(d$cond == "b", 0.5, -0.5)
d$participant <- factor(d$participant); d$item <- factor(d$item)
p <- glmmTMB(y ~ 1 + x + (1 | participant) + (1 | item), d, family = binomial("probit"))
put("probit", fixef(p)$cond); put("probit_se", sqrt(diag(vcov(p)$cond)))
put("probit_sd", sapply(VarCorr(p)$cond, function(v) attr(v, "stddev")))
put("probit_loglik", as.numeric(logLik(p)))
s <- glmmTMB(y ~ 1 + x + (1 | participant) + (0 + x | item), d, family = binomial("probit"))
put("slope", fixef(s)$cond); put("slope_se", sqrt(diag(vcov(s)$cond)))
put("slope_sd", sapply(VarCorr(s)$cond, function(v) attr(v, "stddev")))
put("slope_loglik", as.numeric(logLik(s)))

# Shares of right answers of ideal observers, by numerical integration over what they see.
right <- function(d, m) integrate(function(x) dnorm(x - d) * pnorm(x)^(m - 1), -Inf, Inf, rel.tol = 1e-10)$value
put("alternatives_3", sapply(c(-0.5, 0, 0.5, 1, 2, 4), right, m = 3))
put("alternatives_8", sapply(c(-0.5, 0, 0.5, 1, 2, 4), right, m = 8))
# ABX by differences: X is A; right where |X - A| < |X - B|. Integrate over X given A = 0, B = d.
# |X - A| < |X - B| is (B - A)(B + A - 2 X) > 0; both factors are normal and independent.
abx <- function(d) integrate(function(u) dnorm(u, d, sqrt(2)) * pnorm(sign(u) * d / sqrt(6)), -Inf, Inf, rel.tol = 1e-10)$value
put("abx_differencing", sapply(c(0, 0.5, 1, 2, 4), abx))
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(args[1], "oracle_tasks.json"))
