"""The command line: main.py reads the words, commands.py does them."""

import os

# Before NumPy is imported: a solve holds the libraries of linear algebra to one thread, and what others they have when they are
# loaded spins for a while in vain, a twentieth of all that is computed until the first stage, on two cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
