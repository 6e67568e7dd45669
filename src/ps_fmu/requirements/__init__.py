"""Requirements on pointing errors: read from a file, judged during a run or from stored rows, stated as verdicts."""
