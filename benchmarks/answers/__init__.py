"""Whether answers decide: what users ask for is understood, and what is said is true."""
