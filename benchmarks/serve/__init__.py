"""The server as a product: its speed over each transport, its behaviour with several clients, its conformance."""
