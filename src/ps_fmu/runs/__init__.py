"""The product's scenarios: the runs behind system/run.py."""
