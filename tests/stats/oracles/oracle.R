# Numbers of R that our statistics must repeat, written to oracle.json.
# Run: Rscript tests/stats/oracles/oracle.R tests/stats/oracles [FOLDER_OF_PUBLISHED_TABLES]
# Made with R 4.2.2, glmmTMB 1.1.5, lme4 1.1-31, brglm2 0.9.
suppressMessages({library(glmmTMB); library(lme4); library(brglm2)})
args <- commandArgs(trailingOnly = TRUE)
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))

d <- read.csv(file.path(args[1], "crossed.csv"))
d$participant <- factor(d$participant); d$item <- factor(d$item); d$cond <- factor(d$cond)
g <- glm(y ~ 1 + cond, binomial, d)
put("glm", coef(g)); put("glm_se", sqrt(diag(vcov(g)))); put("glm_loglik", as.numeric(logLik(g)))
m <- glmmTMB(y ~ 1 + cond + (1 | participant) + (1 | item), d, family = binomial)
put("glmm", fixef(m)$cond); put("glmm_se", sqrt(diag(vcov(m)$cond)))
put("glmm_sd", sapply(VarCorr(m)$cond, function(v) attr(v, "stddev"))); put("glmm_loglik", as.numeric(logLik(m)))
l <- glmer(y ~ 1 + cond + (1 | participant) + (1 | item), d, family = binomial)
put("glmer", fixef(l))

# Bradley-Terry by logistic regression, and Firth's penalty, on the counts of a printed figure.
bt <- data.frame(k = c(106, 125, 132), n = 132, ours = c(1, -1, 0), pp = c(-1, 0, -1))
b <- glm(cbind(k, n - k) ~ 0 + ours + pp, binomial, bt)
put("bt", coef(b)); put("bt_se", sqrt(diag(vcov(b))))
f <- glm(cbind(k, n - k) ~ 0 + ours + pp, binomial, bt, method = "brglmFit", type = "AS_mean")
put("bt_firth", coef(f)); put("bt_firth_se", sqrt(diag(vcov(f))))
u <- glm(cbind(132, 0) ~ 1, binomial, method = "brglmFit", type = "AS_mean")
put("unanimous_firth", c(coef(u), sqrt(diag(vcov(u)))))

# Exact binomial tests and limits of the same figure's counts.
counts <- c(26, 27, 125, 126, 132, 16, 109, 110)
put("binom_counts", counts)
put("binom_p", sapply(counts, function(k) binom.test(k, 132)$p.value))
put("binom_low", sapply(counts, function(k) binom.test(k, 132)$conf.int[1]))
put("binom_high", sapply(counts, function(k) binom.test(k, 132)$conf.int[2]))
put("holm", p.adjust(c(0.01, 0.04, 0.03, 0.005), "holm"))

if (length(args) > 1) {
  s <- read.csv(file.path(args[2], "mpdir_Faces2.csv"))
  s$Stim <- factor(s$Stim)
  m <- glmmTMB(Resp ~ Stim + (1 | Obs) + (1 | Image), s, family = binomial)
  cat("Faces2 glmmTMB:", fixef(m)$cond, sqrt(diag(vcov(m)$cond)), as.numeric(logLik(m)), "\n")
}
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(args[1], "oracle.json"))
