-- The days that have a partition of their own, with what decides on dropping one: without a look at
-- its rows, of which a day of a thousand robots has 86 million.
CREATE TABLE history_day (
    -- Days since the epoch, of message time.
    day BIGINT PRIMARY KEY,
    -- When its newest second was received; 0 without any.
    received BIGINT NOT NULL DEFAULT 0,
    row_count BIGINT NOT NULL DEFAULT 0
) WITH (fillfactor = 50);
INSERT INTO history_day (day, received, row_count)
SELECT d.day, coalesce(max(s.received), 0), count(s.t)
FROM (
    SELECT substr(c.relname, 17)::bigint AS day
    FROM pg_inherits AS i JOIN pg_class AS c ON c.oid = i.inhrelid
    WHERE i.inhparent = 'history_second'::regclass AND c.relname ~ '^history_second_d-?[0-9]+$'
) AS d
LEFT JOIN history_second AS s ON s.t >= d.day * 86400 AND s.t < (d.day + 1) * 86400
GROUP BY d.day;

-- Makes the partition of a day since the epoch, unless it is there or rows of it are in the default
-- one already. Whoever serves may run it and needs no right to make tables.
CREATE OR REPLACE FUNCTION history_add_day(day BIGINT) RETURNS void
LANGUAGE plpgsql SECURITY DEFINER SET search_path = public, pg_temp AS $$
DECLARE
    partition TEXT := format('history_second_d%s', day);
BEGIN
    IF to_regclass(partition) IS NULL THEN
        EXECUTE format(
            'CREATE TABLE %I PARTITION OF history_second FOR VALUES FROM (%s) TO (%s)',
            partition, day * 86400, (day + 1) * 86400
        );
        INSERT INTO history_day (day) VALUES (history_add_day.day) ON CONFLICT DO NOTHING;
    END IF;
EXCEPTION
    WHEN duplicate_table OR check_violation OR invalid_object_definition THEN
        NULL;
END
$$;

-- Drops the partitions of days that are over and of which every row was received before a second.
-- Gives the number of rows.
CREATE OR REPLACE FUNCTION history_drop_days(before BIGINT) RETURNS BIGINT
LANGUAGE plpgsql SECURITY DEFINER SET search_path = public, pg_temp AS $$
DECLARE
    old RECORD;
    dropped BIGINT := 0;
BEGIN
    FOR old IN
        DELETE FROM history_day AS d
        WHERE (d.day + 1) * 86400 <= before AND d.received < before
        RETURNING d.day, d.row_count
    LOOP
        EXECUTE format('DROP TABLE IF EXISTS %I', format('history_second_d%s', old.day));
        dropped := dropped + old.row_count;
    END LOOP;
    RETURN dropped;
END
$$;
