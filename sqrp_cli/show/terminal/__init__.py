"""What people see in a terminal: tables, charts and sentences about results."""
