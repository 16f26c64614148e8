# Numbers of base R and of package ordinal for answers graded by confidence, written to
# oracle_confidence.json with the counts that they are of.
# Run: Rscript tests/stats/oracles/oracle_confidence.R tests/stats/oracles
# Made with R 4.2.2, ordinal 2022.11-16.
suppressMessages(library(ordinal))
folder <- commandArgs(trailingOnly = TRUE)[1]
num <- function(x) paste0("[", paste(format(unname(x), digits = 12, trim = TRUE), collapse = ", "), "]")
out <- character()
put <- function(key, x) out <<- c(out, sprintf('  "%s": %s', key, num(x)))

# Counts by grade: surely first answer ... surely second answer; noise, then signal.
cases <- list(
  four = rbind(c(36, 24, 17, 20, 10, 12, 9, 2), c(1, 4, 10, 11, 19, 18, 28, 39)),
  two = rbind(c(40, 25, 12, 8), c(6, 13, 25, 41)),
  # A signal that varies twice as much as the noise, biased to the first answer.
  unequal = rbind(c(90, 60, 40, 20, 8, 2), c(40, 27, 31, 33, 34, 55))
)

# meta-d' by the definition of Maniscalco & Lau (2012): criteria as they are, by Nelder and Mead
# and by a quasi-Newton search from several starts; no code is shared with the Python.
meta <- function(n) {
  k <- ncol(n) / 2
  rates <- apply(n, 1, function(r) sum(r[(k + 1):(2 * k)]) / sum(r))
  d <- qnorm(rates[2]) - qnorm(rates[1])
  c1 <- -(qnorm(rates[1]) + qnorm(rates[2])) / 2
  minus <- function(p) {
    m <- p[1]; mid <- m * c1 / d
    edges <- c(-Inf, p[2:k], mid, p[(k + 1):(2 * k - 1)], Inf)
    if (any(diff(edges) <= 0)) return(1e10)
    total <- 0
    for (s in 1:2) {
      mean <- c(-m / 2, m / 2)[s]
      p_all <- diff(pnorm(edges, mean))
      first <- pnorm(mid, mean)
      p_given <- p_all / rep(c(first, 1 - first), each = k)
      total <- total + sum(n[s, ] * log(p_given))
    }
    -total
  }
  best <- NULL
  for (m in c(0.5, 1, 2) * d) {
    mid <- m * c1 / d
    steps <- seq(0.3, 1.5, length.out = k - 1)
    at <- c(m, mid - rev(steps), mid + steps)
    for (turn in 1:6) {
      at <- optim(at, minus, method = "Nelder-Mead", control = list(maxit = 20000, reltol = 1e-14))$par
      found <- optim(at, minus, method = "BFGS", control = list(maxit = 2000, reltol = 1e-15))
      at <- found$par
    }
    if (is.null(best) || found$value < best$value) best <- found
  }
  c(d, c1, best$par[1], -best$value)
}

for (name in names(cases)) {
  n <- cases[[name]]
  put(paste0(name, "_noise"), n[1, ]); put(paste0(name, "_signal"), n[2, ])
  put(paste0(name, "_meta"), meta(n))
  d <- data.frame(grade = factor(rep(seq_len(ncol(n)), 2), ordered = TRUE),
                  signal = factor(rep(0:1, each = ncol(n))), count = c(n[1, ], n[2, ]))
  f <- clm(grade ~ signal, scale = ~ signal, weights = count, data = d, link = "probit")
  # Mean and logarithm of the standard deviation of the signal's evidence, log likelihood.
  put(paste0(name, "_unequal"), c(f$beta, f$zeta, f$logLik))
}
writeLines(c("{", paste(out, collapse = ",\n"), "}"), file.path(folder, "oracle_confidence.json"))
