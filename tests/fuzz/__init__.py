"""A seeded fuzz of everything that reads a file: good files are spoiled and read back.

``make fuzz N=20000`` runs it, ``python -m fuzz --help`` (in ``tests``) says how to replay a case.
Case ``index`` of ``seed`` is the same everywhere: it draws from its own child of the seed.
"""
