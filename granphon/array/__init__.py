"""The disordered array ball by ball: stencils, equilibrium, linear response."""
