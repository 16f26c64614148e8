# Numbers of lme4, glmmTMB and package ordinal for models whose conditions differ by participant
# and by scene, written to oracle_by_scene.json and the data beside it (by_scene.csv, graded.csv).
# Run: Rscript tests/stats/oracles/oracle_by_scene.R tests/stats/oracles
# Made with R 4.2.2, lme4 1.1-31, glmmTMB 1.1.5, ordinal 2022.11-16.
suppressMessages({library(lme4); library(glmmTMB); library(ordinal)})
folder <- commandArgs(trailingOnly = TRUE)[1]
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))

set.seed(13)
d <- expand.grid(participant = sprintf("P%02d", 1:11), scene = letters[1:6], cond = c("a", "b"), level = 1:3)
person <- as.integer(d$participant); scene <- as.integer(d$scene); b <- as.integer(d$cond)
own <- function(levels, sd) matrix(rnorm(2 * levels, 0, sd), levels)
gap <- function(pc, sc) pc[cbind(person, b)] + sc[cbind(scene, b)]
eta <- rnorm(11, 0, 0.5)[person] + rnorm(6, 0, 0.4)[scene] + gap(own(11, 0.6), own(6, 0.5))
slope <- 0.8 + rnorm(11, 0, 0.5)[person] + rnorm(6, 0, 0.4)[scene]
d$correct <- rbinom(nrow(d), 1, plogis(0.2 + 0.5 * (b == 2) + slope * (d$level - 2) + eta))
d$rt_s <- round(exp(-0.3 + 0.1 * (b == 2) + 0.3 * eta + rnorm(nrow(d), 0, 0.3)), 4)
d$rating <- cut(0.6 * (b == 2) + eta + rnorm(nrow(d)), c(-Inf, -1, -0.2, 0.6, 1.5, Inf), labels = FALSE)
write.csv(d, file.path(folder, "by_scene.csv"), row.names = FALSE, quote = FALSE)
d$level_c <- d$level - mean(d$level)
four <- c("participant", "scene", "participant:cond", "scene:cond")

whole <- correct ~ 1 + level + cond + (1 | participant) + (1 | scene) + (0 + level_c | participant) +
  (0 + level_c | scene) + (1 | participant:cond) + (1 | scene:cond)
g <- glmmTMB(whole, d, family = binomial)
put("right_beta", fixef(g)$cond); put("right_se", sqrt(diag(vcov(g)$cond)))
put("right_sd", sapply(VarCorr(g)$cond, function(v) attr(v, "stddev")))
put("right_loglik", as.numeric(logLik(g)))
less <- c(logLik(glmmTMB(update(whole, . ~ . - level), d, family = binomial)),
          logLik(glmmTMB(update(whole, . ~ . - cond), d, family = binomial)))
put("right_ratio_p", 2 * pt(sqrt(2 * (as.numeric(logLik(g)) - less)), 10, lower.tail = FALSE))

m <- lmer(log(rt_s) ~ 0 + cond + (1 | participant) + (1 | scene) + (1 | participant:cond) + (1 | scene:cond), d)
v <- as.data.frame(VarCorr(m))
put("times_beta", fixef(m)); put("times_se", sqrt(diag(as.matrix(vcov(m)))))
put("times_gap_se", sqrt(sum(c(1, -1) * (as.matrix(vcov(m)) %*% c(1, -1)))))
put("times_sd", v$sdcor[match(c(four, "Residual"), v$grp)]); put("times_loglik", as.numeric(logLik(m)))

r <- transform(d, rating = factor(rating, ordered = TRUE), both = interaction(participant, cond), place = interaction(scene, cond))
for (link in c("probit", "logit")) {
  f <- clmm(rating ~ cond + (1 | participant) + (1 | scene) + (1 | both) + (1 | place), r, link = link)
  put(paste0("rated_", link), f$coefficients)
  put(paste0("rated_", link, "_se"), sqrt(diag(vcov(f)))[seq_along(f$coefficients)])
  put(paste0("rated_", link, "_sd"), sapply(VarCorr(f)[c("participant", "scene", "both", "place")], function(x) attr(x, "stddev")))
  put(paste0("rated_", link, "_loglik"), f$logLik)
}

# Graded comparisons of a with b, either first: what people and scenes like differs by sd sqrt 2.
p <- expand.grid(participant = sprintf("P%02d", 1:11), scene = letters[1:6], first = c("a", "b"), k = 1:2)
p$second <- ifelse(p$first == "a", "b", "a"); p$x <- ifelse(p$first == "b", 1, -1)
liked <- 0.5 + rnorm(11, 0, 0.6)[as.integer(p$participant)] + rnorm(6, 0, 0.5)[as.integer(p$scene)]
p$rating <- cut(p$x * liked + rnorm(nrow(p)), c(-Inf, -1, -0.3, 0.3, 1, Inf), labels = FALSE) - 3
write.csv(p[, c("participant", "scene", "first", "second", "rating")], file.path(folder, "graded.csv"), row.names = FALSE, quote = FALSE)
p$rating <- factor(p$rating, ordered = TRUE)
h <- clmm(rating ~ x + (0 + x | participant) + (0 + x | scene), p, link = "probit")
put("graded", h$coefficients); put("graded_se", sqrt(diag(vcov(h)))[seq_along(h$coefficients)])
put("graded_sd", sapply(VarCorr(h)[c("participant", "scene")], function(x) attr(x, "stddev")) / sqrt(2))
put("graded_loglik", h$logLik)
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_by_scene.json"))
