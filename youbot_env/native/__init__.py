"""Machine code for many robots at once, made from the one description of the physics.

``trace`` records what a function over components does, ``emit`` writes it as C, ``build`` compiles
and loads it.
"""
