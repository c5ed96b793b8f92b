"""Symmetry by fitting, the geometric method compared in Sec. IV-E (its reference [7], Ecins et al. 2018)."""
