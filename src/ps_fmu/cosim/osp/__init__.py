"""libcosim's own description of a system, ``OspSystemStructure.xml``."""
