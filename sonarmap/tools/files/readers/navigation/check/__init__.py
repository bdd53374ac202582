"""What is wrong with navigation that scans contradict."""
