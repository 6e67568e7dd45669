"""FMI calls of any kind to an FMU in a process of its own, and a model of what each has to answer."""
