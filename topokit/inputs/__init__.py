"""What users pass in: files, arrays, and objects of other libraries."""
