"""Who eats the pointing error: each source's, band's and resonance's share of the indices that requirements ask for."""
