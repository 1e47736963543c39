-- Large content. meshway.db says what it is: an object that no row there names is garbage.
CREATE TABLE objects (
    key        TEXT    NOT NULL PRIMARY KEY,     -- made once, and never used again
    made_by    TEXT    NOT NULL,                 -- the process that wrote it
    created_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- An ordinary rowid table: large rows of a WITHOUT ROWID table would fill its tree.
CREATE TABLE chunks (
    object   TEXT    NOT NULL REFERENCES objects (key),
    position INTEGER NOT NULL,                   -- 0, 1, 2, …; all but the last have 256 KiB
    data     BLOB    NOT NULL,
    UNIQUE (object, position)
) STRICT;
