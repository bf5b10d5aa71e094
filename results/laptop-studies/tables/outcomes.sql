-- where each run ended: its final evaluation, or the last one made while training
SELECT run, name, task, misalignment_kind, misalignment_deg, scheme, seed, split, after_episode, episodes,
       mean_return, success_rate, mean_steps_to_success, mean_estimation_error
FROM outcomes()
WHERE run IN (SELECT run FROM runs WHERE status <> 'failed' AND run IN ('laptop/lift-oracle-orbit00-seed2', 'laptop/reach-dense2sparse-orbit10-seed0', 'laptop/reach-dense2sparse-orbit10-seed1', 'laptop/reach-dense2sparse-orbit10-seed2'))
ORDER BY run
