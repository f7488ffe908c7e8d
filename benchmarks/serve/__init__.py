"""The server as a product: how fast it answers by each transport, how it bears several clients, whether it conforms."""
