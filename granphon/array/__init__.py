"""The disordered array ball by ball: stencils, equilibrium, linear response."""

import numpy as np

# glibc gives the memory of a large array back to the system as soon as it is free, and to get it
# again page by page takes longer than to fill it. When an array of nearly 32 MB has been freed
# once, memory of smaller ones is kept for the next (mallopt(3), M_MMAP_THRESHOLD). Its pages are
# not touched, so that it takes none.
np.empty(31 * 2**20, np.uint8)
