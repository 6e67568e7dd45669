"""The scenario wheels: short-time spectra, crossings of harmonics and modes, and how they are shown."""
