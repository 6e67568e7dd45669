"""The paper's numbers and figures from its equations and from the running FMUs: ``ps-fmu analyse``."""
