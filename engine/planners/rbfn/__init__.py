"""MP-RBFN: motion primitives from a network of radial basis functions, and the planner that selects among them."""
