"""Questions over many runs: envelopes, maps, trades, random extremes, measured histories."""
