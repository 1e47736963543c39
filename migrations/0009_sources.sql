-- Which part of its file a job makes a surface of: a JSON object such as {"label": 5}. NULL where the
-- file has no parts, or only one.
ALTER TABLE jobs ADD COLUMN source TEXT;
