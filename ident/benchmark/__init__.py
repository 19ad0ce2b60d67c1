"""The hidden-effect benchmark: robots with a secret, what a diagnosis says of them, and rates."""
