"""Speed of training: gradients, processes, averaged weights."""
