"""What any room may use: documents, files, errors, processes, arrays, spelling."""
