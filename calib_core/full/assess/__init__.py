"""What the answer is worth: observability, influences, disagreement, what of the sensors was found, plausibility."""
