"""What any room may use.

- `documents`, `json_schema`, `spelling`, `retired`: YAML with line numbers, models, names that were
  meant, and names that went; `errors`: lines that say what to mend;
- `files`, `matrices`: results folders and matrices, which may be somebody else's;
- `apart`, `interrupts`, `processors`: processes for user code, signals;
- `cached_code`, `machine_code`, `compiling`, `sources`: compiled code, on disk with its digests;
- `arrays`: types.
"""
