"""Hidden operators of studies: their access to sessions, their script, their page."""
