"""What the answer is worth: residuals, observability, repeatability, plausibility."""
