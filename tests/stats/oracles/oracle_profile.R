# Profile limits of one difference, by lme4, glmmTMB and package ordinal, written to
# oracle_profile.json: where the root of the likelihood ratio is -2 and 2, and the ratio against 0.
# Run: Rscript tests/stats/oracles/oracle_profile.R tests/stats/oracles
# Made with R 4.2.2, lme4 1.1-31, glmmTMB 1.1.5, ordinal 2022.11-16.
suppressMessages({library(lme4); library(glmmTMB); library(ordinal)})
folder <- commandArgs(trailingOnly = TRUE)[1]
d <- read.csv(file.path(folder, "by_scene.csv"))
d$x <- as.numeric(d$cond == "b"); d$level_c <- d$level - mean(d$level)
d$rating <- factor(d$rating, ordered = TRUE)
d$both <- interaction(d$participant, d$cond); d$place <- interaction(d$scene, d$cond)

# logLik where the coefficient of x is held; `free` where it is not.
limits <- function(held, free, at) {
  beyond <- function(v) sqrt(max(2 * (free - held(v)), 0)) - 2
  c(uniroot(beyond, c(at - 2, at), tol = 1e-5)$root, uniroot(beyond, c(at, at + 2), tol = 1e-5)$root,
    2 * (free - held(0)))
}
random <- "(1 | participant) + (1 | scene) + (1 | participant:cond) + (1 | scene:cond)"
times <- function(v) {
  d$o <- v * d$x
  as.numeric(logLik(lmer(as.formula(paste("log(rt_s) ~ 1 + offset(o) +", random)), d, REML = FALSE)))
}
m <- lmer(as.formula(paste("log(rt_s) ~ 1 + x +", random)), d, REML = FALSE)
slopes <- "(0 + level_c | participant) + (0 + level_c | scene)"
right <- function(v) {
  d$o <- v * d$x
  as.numeric(logLik(glmmTMB(as.formula(paste("correct ~ 1 + level + offset(o) +", random, "+", slopes)), d, family = binomial)))
}
g <- glmmTMB(as.formula(paste("correct ~ 1 + level + x +", random, "+", slopes)), d, family = binomial)
rated <- function(v) {
  d$o <- v * d$x
  as.numeric(clmm(rating ~ offset(o) + (1 | participant) + (1 | scene) + (1 | both) + (1 | place), d, link = "probit")$logLik)
}
f <- clmm(rating ~ x + (1 | participant) + (1 | scene) + (1 | both) + (1 | place), d, link = "probit")
num <- function(x) paste0("[", paste(format(unname(x), digits = 9, trim = TRUE), collapse = ", "), "]")
out <- c(sprintf('  "times": %s', num(limits(times, as.numeric(logLik(m)), fixef(m)[["x"]]))),
         sprintf('  "right": %s', num(limits(right, as.numeric(logLik(g)), fixef(g)$cond[["x"]]))),
         sprintf('  "rated": %s', num(limits(rated, f$logLik, f$coefficients[["x"]]))))
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_profile.json"))
