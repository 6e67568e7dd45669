"""Who eats the pointing error: each source's, band's and mode's share of the indices that requirements ask for."""
