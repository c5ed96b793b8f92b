"""Speed of training: gradients, processes, precision, averaged weights."""
