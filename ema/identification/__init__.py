"""From FRFs to modes: LSCF poles, stabilisation, choice of modes, maximum likelihood, shapes."""
