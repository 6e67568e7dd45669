"""The files of the product that are no modules: sources of its FMUs, system descriptions, parameter files."""
