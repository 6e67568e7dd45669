"""From a slave to an FMU file: sources, description, documentation, licences, launcher, bundled Python."""
