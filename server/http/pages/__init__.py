"""The workspace as pages: a client of the server's own tools and resources, with nothing of its own to know."""
