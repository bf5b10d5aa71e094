-- how much was logged
SELECT count(DISTINCT run) AS runs, count(*) AS episodes, sum(length) AS transitions, sum(wall_time_s) AS seconds
FROM episodes
WHERE run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
