"""Is an FMU as the standard asks, and does it run?  For FMUs of any maker."""
