-- every run, of the main matrix and of the studies beside it: what it is, how it went, the hash of what makes it again
SELECT run, name, task, scheme, misalignment_kind, misalignment_deg, seed, status, estimator,
       episodes, final_return, final_success_rate,
       config->>'$.policy.buffer' AS buffer, config->>'$.policy.reset' AS reset, config->>'$.world.robot' AS robot,
       (config->>'$.world.cube_half_range')::DOUBLE AS cube_half_range,
       (config->>'$.policy.episodes')::INT AS training_episodes,
       (config->>'$.policy.td3.gamma')::DOUBLE AS gamma,
       (config->>'$.policy.td3.exploration_noise')::DOUBLE AS exploration_noise,
       (config->>'$.policy.td3.preactivation_penalty')::DOUBLE AS preactivation_penalty, config_sha256,
       run IN ('laptop/lift-oracle-orbit00-seed2', 'laptop/reach-dense2sparse-orbit10-seed0', 'laptop/reach-dense2sparse-orbit10-seed1', 'laptop/reach-dense2sparse-orbit10-seed2') AS main
FROM runs
WHERE (run IN ('laptop/lift-oracle-orbit00-seed2', 'laptop/reach-dense2sparse-orbit10-seed0', 'laptop/reach-dense2sparse-orbit10-seed1', 'laptop/reach-dense2sparse-orbit10-seed2') OR name IN ('laptop-buffer-empty', 'laptop-buffer-relabel', 'laptop-ceiling-estimate', 'laptop-networks-all', 'laptop-networks-critics', 'laptop-switch-50', 'laptop-touch-none', 'laptop-touch-pads'))
ORDER BY run
