"""The pages of a questionnaire in the administration that are no list and no form of Django."""
