-- How far a snapshot can be relied on, as it was judged when it was taken; NULL for results, whose
-- report has it, and for snapshots of earlier versions.
ALTER TABLE meshes ADD COLUMN verdict TEXT CHECK (verdict IN ('good', 'doubtful', 'poor'));
