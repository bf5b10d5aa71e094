-- how wrong the dense reward is, and which way, by how far the gripper truly is from the cube (bins of 2 cm)
SELECT split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, 0.02 * floor(distance_true / 0.02) + 0.01 AS distance,
       avg(abs(reward_dense_est - reward_dense_true)) AS error,
       avg(reward_dense_est - reward_dense_true) AS bias,
       count(*) AS steps
FROM transitions
WHERE scheme <> 'oracle' AND reward_dense_est IS NOT NULL AND distance_true < 0.5 AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
GROUP BY ALL
HAVING steps >= 20
ORDER BY ALL
