-- how much each run logged
SELECT run, count(*) AS episodes, sum(length)::BIGINT AS transitions, sum(wall_time_s) AS seconds
FROM episodes
WHERE run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
GROUP BY run
ORDER BY run
