-- With an object store each cloud is an object of its own: no other row names it, also where another
-- tenant has the same bytes. NULL: the file clouds/<sha256> of the data folder.
ALTER TABLE clouds ADD COLUMN object TEXT;
CREATE UNIQUE INDEX clouds_by_object ON clouds (object);

-- What is known of the database as a whole: its id, by which it finds its objects, and as objects
-- the address of the store that has them, if one does.
CREATE TABLE meta (
    name  TEXT NOT NULL PRIMARY KEY,
    value TEXT NOT NULL
) STRICT, WITHOUT ROWID;
INSERT INTO meta (name, value) VALUES ('id', lower(hex(randomblob(16))));
