"""What every house stands on: errors, findings, bounded fields of configurations, files, clocks."""
