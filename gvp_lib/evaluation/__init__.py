"""How planners are measured: one episode loop, baselines, true errors and their statistics."""
