"""Programs that use other makers' clients as their documentation shows, each in the client's own environment."""
