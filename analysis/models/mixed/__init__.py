"""Mixed models: fits, random effects, marginal means, likelihood ratios by simulation."""
