"""What `doctor` looks at: packages, torch and GPU, the machine, the default weights."""
