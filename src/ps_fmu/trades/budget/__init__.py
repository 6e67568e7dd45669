"""Where the pointing error comes from: share of each source, band and resonance in the indices of requirements."""
