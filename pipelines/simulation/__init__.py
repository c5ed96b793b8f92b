"""What `simulate` is made of: a table with objects, a hand, trials and their record."""
