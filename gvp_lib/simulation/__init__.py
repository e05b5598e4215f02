"""The simulated work cell. MuJoCo and mink live here; only this room knows the truth."""
