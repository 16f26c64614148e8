# Profile limits of random effects, and modes with conditional errors, by lme4 and glmmTMB, of the
# data in times.csv; written to oracle_deviations.json.
# Run: Rscript tests/stats/oracles/oracle_deviations.R tests/stats/oracles
# Made with R 4.2.2, lme4 1.1-31, glmmTMB 1.1.5, ordinal 2022.11-16.
suppressMessages({library(lme4); library(glmmTMB); library(ordinal)})
folder <- commandArgs(trailingOnly = TRUE)[1]
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))
d <- read.csv(file.path(folder, "times.csv"))
d$participant <- factor(d$participant); d$scene <- factor(d$scene)

# Where the likelihood, with one deviation held, falls by half the quantile of chi-square (1):
# glmmTMB fits the model anew for each value of the logarithm of the deviation.
limits <- function(m, part, k) {
  full <- m$fit$parfull
  best <- full[names(full) == part][k]
  # The dispersion is a variance's logarithm.
  half <- if (part == "betad") 0.5 else 1
  cut <- qchisq(0.95, 1) / 2
  fall <- function(v) {
    start <- list(theta = unname(full[names(full) == "theta"]), betad = unname(full[names(full) == "betad"]))
    held <- list(); held[[part]] <- seq_along(start[[part]]); held[[part]][k] <- NA
    held[[part]] <- factor(held[[part]], levels = setdiff(seq_along(start[[part]]), k))
    start[[part]][k] <- v
    if (family(m)$family == "binomial") start$betad <- NULL
    as.numeric(logLik(m)) - as.numeric(logLik(update(m, start = start, map = held))) - cut
  }
  root <- function(side) {
    far <- if (side > 0) max(best, -4 / half) else best
    for (turn in 1:40) {
      near <- far; far <- far + side * 0.2 / half
      if (isTRUE(fall(far) > 0)) return(uniroot(fall, sort(c(near, far)), tol = 1e-7)$root)
    }
    -Inf
  }
  low <- root(-1); high <- root(1)
  exp(half * c(low, high))
}
deviations <- function(m, key, names) for (k in seq_along(names)) {
  if (names[k] == "residual") put(paste0(key, "_residual"), limits(m, "betad", 1))
  else put(paste0(key, "_", names[k]), limits(m, "theta", k))
}
m <- glmmTMB(log(rt_s) ~ 0 + cond + (1 | participant) + (1 | scene), d, REML = TRUE)
deviations(m, "times", c("participant", "scene", "residual"))
l <- lmer(log(rt_s) ~ 0 + cond + (1 | participant) + (1 | scene), d)
put("times_sd", c(as.data.frame(VarCorr(l))$sdcor))
r <- as.data.frame(ranef(l, condVar = TRUE))
for (g in c("participant", "scene")) {
  own <- r[r$grpvar == g, ]; own <- own[order(as.character(own$grp)), ]
  put(paste0("times_modes_", g), own$condval); put(paste0("times_errors_", g), own$condsd)
}
d$hit <- as.integer(d$rating > 2)
g <- glmmTMB(hit ~ cond + (1 | participant) + (1 | scene), d, family = binomial)
deviations(g, "right", c("participant", "scene"))
b <- glmer(hit ~ cond + (1 | participant) + (1 | scene), d, family = binomial,
           control = glmerControl(optimizer = "bobyqa", optCtrl = list(maxfun = 1e5)))
put("right_sd", as.data.frame(VarCorr(b))$sdcor)
r <- as.data.frame(ranef(b, condVar = TRUE))
for (k in c("participant", "scene")) {
  own <- r[r$grpvar == k, ]; own <- own[order(as.character(own$grp)), ]
  put(paste0("right_modes_", k), own$condval); put(paste0("right_errors_", k), own$condsd)
}
# One random effect, whose deviation clmm2 profiles.
d$grade <- factor(d$rating, ordered = TRUE)
o <- clmm2(grade ~ cond, random = participant, data = d, link = "probit", Hess = TRUE)
put("ratings_sd", o$stDev)
put("ratings_participant", confint(profile(o, range = c(0.1, 4), nSteps = 30)))
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_deviations.json"))
