"""Files from and for people: tables for downloads, and uploads read under limits."""
