"""What a run leaves: observers, figures, tables, report, summary."""
