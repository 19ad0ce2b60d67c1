"""Which physical effect is missing: candidates, verdicts and the experiment that separates them."""
