"""Checks FMUs of any maker: archive, model description, behaviour, reference runs."""
