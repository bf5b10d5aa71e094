-- first training episode under the sparse reward
SELECT split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, min(episode) AS switch_episode
FROM episodes
WHERE scheme = 'dense2sparse' AND split = 'train' AND phase = 'sparse' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND run IN ('laptop/lift-oracle-orbit00-seed2', 'laptop/reach-dense2sparse-orbit10-seed0', 'laptop/reach-dense2sparse-orbit10-seed1', 'laptop/reach-dense2sparse-orbit10-seed2'))
GROUP BY ALL
ORDER BY ALL
