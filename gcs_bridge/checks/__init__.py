"""The checks, one file each: pairs of descriptions in; residual, limit and what was judged out. No vehicle here."""
