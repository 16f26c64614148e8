# Bradley-Terry strengths by logistic regression, on the votes of the fixed study `preference`.
# Run: Rscript tests/stats/oracles/oracle_strengths.R tests/stats/oracles
# Made with R 4.2.2.
folder <- commandArgs(trailingOnly = TRUE)[1]
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))

# Votes of the first over the second, and how often they were compared.
pairs <- data.frame(blur = c(1, 1, 0), ours = c(-1, 0, 1), plain = c(0, -1, -1))
votes <- list(large = cbind(c(3, 9, 10), 18), small = cbind(c(6, 5, 9), 18))
for (size in names(votes)) {
  k <- votes[[size]][, 1]
  g <- glm(cbind(k, votes[[size]][, 2] - k) ~ 0 + blur + ours, binomial, pairs)
  b <- c(coef(g), 0)
  put(size, b - mean(b))
  put(paste0(size, "_odds"), exp(c(b[1] - b[2], b[1] - b[3], b[2] - b[3])))
  put(paste0(size, "_loglik"), sum(dbinom(k, 18, fitted(g), log = TRUE) - lchoose(18, k)))
}
# Thirty people each compare three methods twice: the errors of independent votes.
k <- c(36, 44, 39)
g <- glm(cbind(k, 60 - k) ~ 0 + blur + ours, binomial, pairs)
b <- c(coef(g), 0)
centre <- diag(3)[, 1:2] - matrix(1 / 3, 3, 2)
put("independent", b - mean(b))
put("independent_se", sqrt(diag(centre %*% vcov(g) %*% t(centre))))
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_strengths.json"))
