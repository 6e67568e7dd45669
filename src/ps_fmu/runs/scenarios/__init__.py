"""The scenarios of the product: each file here is one, found by its name SCENARIO."""
