# Likelihood ratios, contrasts and means by hand-made matrices, and p by parametric bootstrap, of
# lme4, glmmTMB and package ordinal, written to oracle_margins.json (of times.csv, by_scene.csv).
# Run: Rscript tests/stats/oracles/oracle_margins.R tests/stats/oracles
# Made with R 4.2.2, lme4 1.1-31, glmmTMB 1.1.5, ordinal 2022.11-16.
suppressMessages({library(lme4); library(glmmTMB); library(ordinal)})
folder <- commandArgs(trailingOnly = TRUE)[1]
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))

d <- read.csv(file.path(folder, "times.csv"), stringsAsFactors = TRUE)
d$both <- interaction(d$participant, d$cond); d$place <- interaction(d$scene, d$cond)
d$rating <- factor(d$rating, ordered = TRUE)
random <- "(1 | participant) + (1 | both) + (1 | scene) + (1 | place)"
of <- function(left, fixed) as.formula(paste(left, "~", fixed, "+", random))
quiet <- function(x) suppressWarnings(suppressMessages(x))
times <- quiet(lmer(of("log(rt_s)", "0 + cond"), d, REML = FALSE))
rated <- clmm(of("rating", "cond"), data = d, link = "probit")
ratios <- sapply(list(c("a", "b"), c("a", "c"), c("b", "c")), function(pair) {
  e <- transform(d, one = factor(ifelse(cond %in% pair, "x", as.character(cond))))
  c(logLik(times) - logLik(quiet(lmer(of("log(rt_s)", "0 + one"), e, REML = FALSE))),
    logLik(rated) - logLik(clmm(of("rating", "one"), data = e, link = "probit")))
})
put("times_ratio", 2 * ratios[1, ]); put("rated_ratio", 2 * ratios[2, ])

reml <- quiet(lmer(of("log(rt_s)", "0 + cond"), d))
weights <- c(1, -1 / 2, -1 / 2)
put("times_contrast", c(sum(weights * fixef(reml)), sqrt(drop(weights %*% as.matrix(vcov(reml)) %*% weights))))
top <- nlevels(d$rating) - 1
middle <- cbind(matrix(-1 / top, 3, top), rbind(0, diag(2)))
keep <- seq_len(top + 2)
put("rated_means", middle %*% rated$coefficients)
v <- middle %*% vcov(rated)[keep, keep] %*% t(middle)
put("rated_means_se", sqrt(diag(v)))
put("rated_contrast", c(weights %*% middle %*% rated$coefficients, sqrt(weights %*% v %*% weights)))

s <- read.csv(file.path(folder, "by_scene.csv")); s$level_c <- s$level - mean(s$level)
right <- glmmTMB(correct ~ 1 + level + cond + (1 | participant) + (1 | scene) + (0 + level_c | participant) +
  (0 + level_c | scene) + (1 | participant:cond) + (1 | scene:cond), s, family = binomial)
rows <- rbind(c(1, mean(s$level), 0), c(1, mean(s$level), 1))
put("right_means", rows %*% fixef(right)$cond)
put("right_means_se", sqrt(diag(rows %*% vcov(right)$cond %*% t(rows))))

few <- droplevels(subset(d, participant %in% sprintf("P%02d", 1:6) & scene %in% c("a", "b", "c") & cond != "a"))
f <- quiet(lmer(of("log(rt_s)", "0 + cond"), few, REML = FALSE))
g <- quiet(lmer(of("log(rt_s)", "1"), few, REML = FALSE))
observed <- as.numeric(2 * (logLik(f) - logLik(g)))
drawn <- sapply(simulate(g, 400, seed = 1), function(y) 2 * (logLik(quiet(refit(f, y))) - logLik(quiet(refit(g, y)))))
put("few_ratio", observed); put("few_bootstrap_p", (1 + sum(drawn >= observed)) / 401)
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_margins.json"))
