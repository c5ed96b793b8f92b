"""Symmetry by fitting, the geometric method of Sec. IV-E (reference [7], Ecins et al. 2018)."""
