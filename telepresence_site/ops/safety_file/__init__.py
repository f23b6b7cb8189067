"""The file for people who assess an installation: what it must do, shows, and has measured."""
