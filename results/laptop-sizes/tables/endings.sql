-- how final episodes end, by whether the task is done at the last step (reach: touch or 3 cm; lift: lifted): kept (and
-- done in 19 of 20 steps since it first was), regained, lost, never; fallen: whatever was done, the cube ends off the
-- table
WITH episode AS (
    SELECT run, task, misalignment_kind, misalignment_deg, scheme, episode, sum(reward_dense_true) AS return,
           arg_max(success, step) AS is_done, count(*) FILTER (WHERE success) AS done,
           min(step) FILTER (WHERE success) AS first_done, max(step) AS last_step,
           arg_max(cube_true_z, step) - arg_min(cube_true_z, step) AS rise
    FROM transitions
    WHERE split = 'final' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
    GROUP BY ALL
), ended AS (
    SELECT *, CASE WHEN rise < -0.05 THEN 'fallen'
                   WHEN done = 0 THEN 'never'
                   WHEN NOT is_done THEN 'lost'
                   WHEN done >= 0.95 * (last_step + 1 - first_done) THEN 'kept'
                   ELSE 'regained' END AS ending
    FROM episode
)
SELECT split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, count(*) AS episodes,
       count(*) FILTER (WHERE ending = 'kept') AS kept, avg(return) FILTER (WHERE ending = 'kept') AS kept_return,
       count(*) FILTER (WHERE ending = 'regained') AS regained, avg(return) FILTER (WHERE ending = 'regained') AS regained_return,
       count(*) FILTER (WHERE ending = 'lost') AS lost, avg(return) FILTER (WHERE ending = 'lost') AS lost_return,
       count(*) FILTER (WHERE ending = 'never') AS never, avg(return) FILTER (WHERE ending = 'never') AS never_return,
       count(*) FILTER (WHERE ending = 'fallen') AS fallen, avg(return) FILTER (WHERE ending = 'fallen') AS fallen_return
FROM ended
GROUP BY ALL
ORDER BY ALL
