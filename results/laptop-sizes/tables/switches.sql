-- first training episode under the sparse reward
SELECT split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, min(episode) AS switch_episode
FROM episodes
WHERE scheme = 'dense2sparse' AND split = 'train' AND phase = 'sparse' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
GROUP BY ALL
ORDER BY ALL
