# Numbers of lme4 for the model of all pairings, and likelihood ratios, written to oracle_paired.json.
# Run: Rscript tests/stats/oracles/oracle_paired.R tests/stats/oracles
# Made with R 4.2.2, lme4 1.1-31, glmmTMB 1.1.5.
suppressMessages(library(lme4))
args <- commandArgs(trailingOnly = TRUE)
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))

d <- read.csv(file.path(args[1], "paired.csv"))
names3 <- c("a", "b", "c")
x <- sapply(names3, function(m) (d$first == m) - (d$second == m))
d$xb <- x[, "b"]; d$xc <- x[, "c"]; d$xbc <- d$xb + d$xc
d$y <- d$chose_first

# lme4 gives a trial one level of a factor. Ours has two: the first method's with +1, the
# second's with -1; so the sparse matrix of random effects is changed before the fit.
taste <- function(group, method, every) factor(paste(group, method), levels = every)
for (g in c("participant", "scene")) {
  every <- as.vector(outer(unique(d[[g]]), names3, paste))
  d[[paste0(g, "_first")]] <- taste(d[[g]], d$first, every)
  d[[paste0(g, "_second")]] <- taste(d[[g]], d$second, every)
}
fit <- function(formula) {
  parts <- glFormula(formula, d, family = binomial)
  tight <- glmerControl(tolPwrss = 1e-12)
  second <- rbind(fac2sparse(d$participant_second), fac2sparse(d$scene_second))
  second <- second[rownames(parts$reTrms$Zt), ]
  parts$reTrms$Zt <- parts$reTrms$Zt - second
  f <- do.call(mkGlmerDevfun, c(parts, list(control = tight)))
  o <- optimizeGlmer(f)
  f <- updateGlmerDevfun(f, parts$reTrms)
  o <- optimizeGlmer(f, stage = 2, control = list(xtol_abs = 1e-10, ftol_abs = 1e-12), optimizer = "nloptwrap")
  mkMerMod(environment(f), o, parts$reTrms, fr = parts$fr)
}
random <- y ~ 1 + xb + xc + (1 | participant_first) + (1 | scene_first)
m <- fit(random)
put("beta", fixef(m)); put("beta_se", sqrt(diag(as.matrix(vcov(m, use.hessian = TRUE)))))
put("sd", sapply(VarCorr(m), function(v) attr(v, "stddev"))); put("loglik", as.numeric(logLik(m)))
put("ratio_ab", 2 * (logLik(m) - logLik(fit(update(random, . ~ . - xb)))))
put("ratio_ac", 2 * (logLik(m) - logLik(fit(update(random, . ~ . - xc)))))
put("ratio_bc", 2 * (logLik(m) - logLik(fit(update(random, . ~ . - xb - xc + xbc)))))

# Likelihood ratios of glmmTMB for each coefficient of the model of crossed.csv in oracle.R.
suppressMessages(library(glmmTMB))
d <- read.csv(file.path(args[1], "crossed.csv"))
d$b <- as.numeric(d$cond == "b")
likelihood <- function(f) as.numeric(logLik(glmmTMB(f, d, family = binomial)))
full <- likelihood(y ~ 1 + b + (1 | participant) + (1 | item))
less <- c(likelihood(y ~ 0 + b + (1 | participant) + (1 | item)), likelihood(y ~ 1 + (1 | participant) + (1 | item)))
put("glmm_ratio_p", pchisq(2 * (full - less), 1, lower.tail = FALSE))
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(args[1], "oracle_paired.json"))
