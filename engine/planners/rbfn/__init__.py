"""MP-RBFN: motion primitives from a network of radial basis functions, and the planner that chooses among them."""
