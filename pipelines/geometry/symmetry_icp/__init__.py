"""Symmetry by fitting, the geometric rival of Sec. IV-E (its reference [7], Ecins et al. 2018)."""
