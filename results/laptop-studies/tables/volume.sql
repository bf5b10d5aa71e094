-- how much was logged
SELECT count(DISTINCT run) AS runs, count(*) AS episodes, sum(length) AS transitions, sum(wall_time_s) AS seconds
FROM episodes
WHERE run IN (SELECT run FROM runs WHERE status <> 'failed' AND run IN ('laptop/lift-oracle-orbit00-seed2', 'laptop/reach-dense2sparse-orbit10-seed0', 'laptop/reach-dense2sparse-orbit10-seed1', 'laptop/reach-dense2sparse-orbit10-seed2'))
