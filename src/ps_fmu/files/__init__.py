"""Files, archives and XML: read without trust in what is in them, and written complete or not at all."""
