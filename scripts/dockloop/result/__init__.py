"""What a run left behind, as plain data: its recording, summary, criteria, errors, files."""
