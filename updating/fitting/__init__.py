"""Contact parameters by opt_G and opt_d, and weighted least squares over several configurations."""
