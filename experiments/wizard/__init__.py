"""Hidden operators of studies: who they are, their script, their page."""
