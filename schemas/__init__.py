"""The file formats: JSON Schemas, and the frozen types of plan and world."""
