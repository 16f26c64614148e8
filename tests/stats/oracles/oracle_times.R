# Numbers of lme4 for reaction times, and of package ordinal for ratings, written to
# oracle_times.json and the data beside it (times.csv).
# Run: Rscript tests/stats/oracles/oracle_times.R tests/stats/oracles
# Made with R 4.2.2, lme4 1.1-31, ordinal 2022.11-16.
suppressMessages({library(lme4); library(ordinal)})
folder <- commandArgs(trailingOnly = TRUE)[1]
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))

set.seed(7)
d <- expand.grid(participant = sprintf("P%02d", 1:9), scene = letters[1:5], cond = c("a", "b", "c"), k = 1:3)
p <- rnorm(9, 0, 0.25); s <- rnorm(5, 0, 0.1); i <- rnorm(27, 0, 0.08)
person <- as.integer(d$participant); cond <- as.integer(factor(d$cond))
eta <- p[person] + s[as.integer(factor(d$scene))] + i[(person - 1) * 3 + cond]
d$rt_s <- round(exp(-0.2 + c(0, 0.1, 0.25)[cond] + eta + rnorm(nrow(d), 0, 0.3)), 4)
latent <- c(0, 0.6, 1.5)[cond] + 3 * eta + rlogis(nrow(d))
d$rating <- cut(latent, c(-Inf, -1, 0, 1, 2, Inf), labels = FALSE)
d$correct <- as.integer(runif(nrow(d)) < 0.8)
write.csv(d[, c("participant", "scene", "cond", "rt_s", "rating", "correct")],
          file.path(folder, "times.csv"), row.names = FALSE, quote = FALSE)

m <- lmer(log(rt_s) ~ 0 + cond + (1 | participant) + (1 | participant:cond) + (1 | scene), d)
v <- as.data.frame(VarCorr(m))
put("times_beta", fixef(m)); put("times_se", sqrt(diag(as.matrix(vcov(m)))))
put("times_sd", v$sdcor[match(c("participant", "participant:cond", "scene", "Residual"), v$grp)])
put("times_loglik", as.numeric(logLik(m)))
n <- lmer(log(rt_s) ~ 0 + cond + (1 | participant) + (1 | participant:cond), d)
w <- as.data.frame(VarCorr(n))
put("nested_beta", fixef(n)); put("nested_se", sqrt(diag(as.matrix(vcov(n)))))
put("nested_sd", w$sdcor[match(c("participant", "participant:cond", "Residual"), w$grp)])

d$rating <- factor(d$rating, ordered = TRUE); d$cond <- factor(d$cond)
d$participant <- factor(d$participant); d$scene <- factor(d$scene)
f <- clm(rating ~ cond, data = d)
put("clm", f$coefficients); put("clm_se", sqrt(diag(vcov(f)))); put("clm_loglik", f$logLik)
for (link in c("logit", "probit")) {
  g <- clmm(rating ~ cond + (1 | participant) + (1 | scene), data = d, link = link)
  put(paste0("clmm_", link), g$coefficients)
  put(paste0("clmm_", link, "_se"), sqrt(diag(vcov(g)))[seq_along(g$coefficients)])
  put(paste0("clmm_", link, "_sd"), sapply(VarCorr(g)[c("participant", "scene")], function(x) attr(x, "stddev")))
  put(paste0("clmm_", link, "_loglik"), g$logLik)
}
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_times.json"))
