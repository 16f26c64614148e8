"""Classic push-pull (Gortler et al. 1996): the naive rival, and the pattern for later stages."""
