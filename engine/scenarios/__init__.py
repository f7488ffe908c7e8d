"""CommonRoad scenarios: safe reading, recorded tracks, facts, generation and validation."""
