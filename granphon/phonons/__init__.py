"""Force constants for ASE and phonopy; bands and densities of states."""
