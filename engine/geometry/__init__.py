"""Plane geometry of polylines and oriented rectangles, in numpy."""
