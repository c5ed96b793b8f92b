"""Progress of a training: terminal display and curves."""
