"""How the planners are measured: errors, their statistics, and the results that are stored."""
