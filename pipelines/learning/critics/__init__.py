"""Training of the critics: rows of candidates with their truth, and fits to these rows."""
