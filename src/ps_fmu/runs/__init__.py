"""The product's scenarios: the runs behind ``ps-fmu run``."""
