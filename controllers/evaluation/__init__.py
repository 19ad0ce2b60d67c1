"""How well controllers track: robots, cases, runs, statistics.

The only room of the project that holds true robots and controllers at once.  No controller imports
it, and what it gives a controller is a model and observations.
"""
