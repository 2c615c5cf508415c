"""The laboratory: accuracy against the reference surface, cost, sweeps, charts, stability."""
