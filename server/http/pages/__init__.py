"""The workspace as web pages: a client of the server's own tools and resources, without logic of its own."""
